"""Crazyflie: 30 g under four rotors of unknown gain, with little thrust to spare."""

from nsaid_mj import NullspaceAID, QuadrotorFlight, QuadrotorPlant, Scenario, main

scenario = Scenario(
    plant=QuadrotorPlant(vehicle="crazyflie"),
    excitation=QuadrotorFlight(
        radius=6.0,
        speed=5.0,
        climb=2.5,
        yaw_rate=8.0,
        tilt=0.6,
        attitude_bandwidth=3.0,
        dither=0.2,
        low=3.0,
        high=9.0,
    ),
    identifier=NullspaceAID(K=20.0, gain=100.0, rate=2.0, floor=2e-3),
    initial_error=0.3,
    duration=300.0,
    dt=2.5e-3,
    pe_window=20.0,
    held_out=30.0,
    record_every=4,
)

if __name__ == "__main__":
    main(scenario)
