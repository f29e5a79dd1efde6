"""UR5: six motors of unknown gain move six links of unknown inertia."""

from nsaid_mj import ArmPlant, FourierTracking, NullspaceAID, Scenario, main

scenario = Scenario(
    plant=ArmPlant(robot="ur5", damping=2.0, friction=1.0, armature=0.1),
    excitation=FourierTracking(fundamental=0.2, harmonics=10, speed=3.0),
    identifier=NullspaceAID(K=20.0, gain=0.3, rate=2.0),
    initial_error=0.3,
    duration=60.0,
    dt=2e-3,  # the robot's own interface runs at 500 Hz
)

if __name__ == "__main__":
    main(scenario)
