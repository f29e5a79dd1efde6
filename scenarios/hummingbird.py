"""Hummingbird: four rotors of unknown gain carry a quadrotor of unknown mass and drag."""

from nsaid_mj import NullspaceAID, QuadrotorFlight, QuadrotorPlant, Scenario, main

scenario = Scenario(
    plant=QuadrotorPlant(model="hummingbird"),
    excitation=QuadrotorFlight(),
    identifier=NullspaceAID(K=10.0, gain=0.5),
    initial_error=0.3,
    duration=300.0,
    dt=0.01,
    pe_window=20.0,
    held_out=30.0,
)

if __name__ == "__main__":
    main(scenario)
