"""Franka Panda with its gripper: seven revolute and two prismatic joints, 126 parameters."""

from nsaid_mj import ArmPlant, FourierTracking, NullspaceAID, Scenario, main

scenario = Scenario(
    plant=ArmPlant(robot="panda", damping=2.0, friction=1.0, armature=0.2),
    excitation=FourierTracking(fundamental=0.2, harmonics=10),
    identifier=NullspaceAID(K=20.0, gain=0.3),
    initial_error=0.3,
    duration=60.0,
)

if __name__ == "__main__":
    main(scenario)
