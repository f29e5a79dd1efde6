"""Adaptive tracking: a UR5 with gains and masses 40 % wrong follows a persistent trajectory."""

from nsaid_mj import AdaptiveTracking, ArmPlant, NullspaceAID, Scenario, main

scenario = Scenario(
    plant=ArmPlant(robot="ur5", damping=2.0, friction=1.0, armature=0.1),
    excitation=AdaptiveTracking(fundamental=0.2, harmonics=8, speed=2.5),
    identifier=NullspaceAID(K=20.0, gain=0.3, law="memory"),
    initial_error=0.4,
    gain_error=0.4,
    duration=30.0,
    dt=1e-3,
)

if __name__ == "__main__":
    main(scenario)
