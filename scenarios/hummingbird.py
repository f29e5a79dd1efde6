"""Hummingbird: four rotors of unknown thrust and torque carry a body of unknown mass and drag."""

from nsaid_mj import NullspaceAID, QuadrotorFlight, QuadrotorPlant, Scenario, main

scenario = Scenario(
    plant=QuadrotorPlant(vehicle="hummingbird"),
    excitation=QuadrotorFlight(
        radius=6.0, speed=8.0, climb=5.0, yaw_rate=5.0, dither=0.5, low=3.0, high=9.0
    ),
    identifier=NullspaceAID(K=20.0, gain=4.0, rate=2.0, floor=2e-3),
    initial_error=0.3,
    duration=300.0,
    dt=2.5e-3,
    pe_window=20.0,
    held_out=30.0,
    record_every=4,
)

if __name__ == "__main__":
    main(scenario)
