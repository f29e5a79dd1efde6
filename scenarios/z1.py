"""Unitree Z1 with its gripper: seven motors of unknown gain, links of half a kilogram to one."""

from nsaid_mj import ArmPlant, FourierTracking, NullspaceAID, Scenario, main

scenario = Scenario(
    plant=ArmPlant(robot="z1", damping=1.0, friction=1.0, armature=0.05),
    excitation=FourierTracking(fundamental=0.2, harmonics=10, speed=3.0),
    identifier=NullspaceAID(K=20.0, gain=1.0),
    initial_error=0.3,
    duration=20.0,
    dt=2e-3,
)

if __name__ == "__main__":
    main(scenario)
