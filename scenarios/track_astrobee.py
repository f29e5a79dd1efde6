"""Adaptive tracking: an Astrobee with nozzles and mass 40 % wrong follows a moving pose."""

from nsaid_mj import (
    AdaptiveTracking,
    AstrobeePlant,
    MemoryConfig,
    NullspaceAID,
    Scenario,
    main,
)

scenario = Scenario(
    plant=AstrobeePlant(),
    excitation=AdaptiveTracking(
        rate=0.2,
        damping=0.8,
        adaptation=2.0,
        period=2.0,
        fundamental=0.01,
        harmonics=4,
        travel=0.4,
        tilt=0.3,
        heading=0.6,
    ),
    identifier=NullspaceAID(
        K=1.0, gain=100.0, floor=1e-3, law="memory", memory=MemoryConfig(window=2.0)
    ),
    initial_error=0.4,
    gain_error=0.4,
    duration=240.0,
    dt=0.016,
    pe_window=20.0,
    held_out=30.0,
)

if __name__ == "__main__":
    main(scenario)
