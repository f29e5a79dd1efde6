"""Adaptive tracking: a BlueROV2 with an arm, as one system with gains and masses 40 % wrong."""

from nsaid_mj import AdaptiveTracking, NullspaceAID, Scenario, UvmsPlant, main

scenario = Scenario(
    plant=UvmsPlant(),
    excitation=AdaptiveTracking(
        rate=1.5,
        damping=6.0,
        adaptation=20.0,
        period=0.5,
        fundamental=0.04,
        harmonics=5,
        reach=0.6,
        speed=0.5,
        travel=0.4,
        tilt=0.2,
        heading=0.8,
    ),
    identifier=NullspaceAID(K=20.0, gain=1.0, rate=0.5, law="memory"),
    initial_error=0.4,
    gain_error=0.4,
    duration=60.0,
    dt=5e-3,
    pe_window=20.0,
    held_out=30.0,
)

if __name__ == "__main__":
    main(scenario)
