"""Astrobee: twelve nozzles of unknown gain move a free-flyer of unknown mass and inertia."""

from nsaid_mj import AstrobeePlant, MemoryConfig, NullspaceAID, PoseHold, Scenario, main

scenario = Scenario(
    plant=AstrobeePlant(),
    excitation=PoseHold(),
    identifier=NullspaceAID(
        K=1.0,
        gain=100.0,
        floor=1e-3,
        memory=MemoryConfig(
            window=2.0
        ),  # it moves by centimetres: noise calls for longer averaging
    ),
    initial_error=0.3,
    duration=300.0,
    dt=0.016,  # the robot's own controller runs at 62.5 Hz
    pe_window=20.0,
    held_out=30.0,
)

if __name__ == "__main__":
    main(scenario)
