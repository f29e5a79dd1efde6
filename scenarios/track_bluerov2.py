"""Adaptive tracking: a BlueROV2 with thrusters and masses 40 % wrong follows a moving pose."""

from nsaid_mj import AdaptiveTracking, BlueROV2Plant, NullspaceAID, Scenario, main

scenario = Scenario(
    plant=BlueROV2Plant(),
    excitation=AdaptiveTracking(
        rate=1.5,
        damping=6.0,
        adaptation=15.0,
        period=0.5,
        fundamental=0.04,
        harmonics=5,
        travel=0.4,
        tilt=0.2,
        heading=0.8,
    ),
    identifier=NullspaceAID(K=6.0, gain=0.6, floor=1e-3, law="memory"),
    initial_error=0.4,
    gain_error=0.4,
    duration=60.0,
    dt=0.01,
    pe_window=20.0,
    held_out=30.0,
)

if __name__ == "__main__":
    main(scenario)
