"""F1TENTH: a race car of unknown load, tyres, drive and resistances, at any speed but walking."""

from nsaid_mj import Driving, F1TenthPlant, NullspaceAID, Scenario, main

scenario = Scenario(
    plant=F1TenthPlant(),
    excitation=Driving(speed=8.0, pace_low=0.2, pace_high=0.8, steer_low=0.5, steer_high=5.0),
    identifier=NullspaceAID(K=8.0, gain=8.0),
    initial_error=0.3,
    duration=600.0,
    dt=0.004,
    pe_window=20.0,
    held_out=30.0,
)

if __name__ == "__main__":
    main(scenario)
