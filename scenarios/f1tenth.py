"""F1TENTH: a race car at one tenth scale with unknown load, tyres, drive and resistances."""

from nsaid_mj import Driving, F1TenthPlant, NullspaceAID, Scenario, main

scenario = Scenario(
    plant=F1TenthPlant(),
    excitation=Driving(speed=8.0, variation=0.55),
    identifier=NullspaceAID(K=6.0, gain=6.0, rate=5.0),
    initial_error=0.3,
    duration=600.0,
    dt=0.004,
    pe_window=20.0,
    held_out=30.0,
)

if __name__ == "__main__":
    main(scenario)
