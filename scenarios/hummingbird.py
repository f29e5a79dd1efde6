"""Hummingbird: four rotors of unknown gain carry a quadrotor of unknown mass and drag."""

from nsaid_mj import NullspaceAID, QuadrotorFlight, QuadrotorPlant, Scenario, main

scenario = Scenario(
    plant=QuadrotorPlant(model="hummingbird"),
    excitation=QuadrotorFlight(
        radius=6.0,
        speed=8.0,
        yaw_rate=3.0,
        dither=0.4,
        low=2.0,
        high=6.0,
        attitude_bandwidth=2.0,
        climb=0.6,
    ),
    identifier=NullspaceAID(K=5.0, gain=5.0),
    initial_error=0.3,
    duration=300.0,
    dt=0.0025,
    pe_window=20.0,
    held_out=30.0,
    record_every=4,
)

if __name__ == "__main__":
    main(scenario)
