"""Rover."""

from nsaid_mj import Driving, NullspaceAID, RoverPlant, Scenario, main

scenario = Scenario(
    plant=RoverPlant(),
    excitation=Driving(
        speed=2.0, variation=0.2, pace_low=0.1, pace_high=0.6, grip=1.0,
        steer_low=0.05, steer_high=0.4, ground=40.0,
    ),
    identifier=NullspaceAID(K=10.0, gain=0.05),
    initial_error=0.3,
    duration=300.0,
    dt=0.005,
    pe_window=20.0,
    held_out=30.0,
)  # fmt: skip

if __name__ == "__main__":
    main(scenario)
