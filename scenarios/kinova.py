"""Kinova Jaco: six slow motors of unknown gain, three of them on continuous joints."""

from nsaid_mj import ArmPlant, FourierTracking, NullspaceAID, Scenario, main

scenario = Scenario(
    plant=ArmPlant(robot="kinova", damping=1.0, friction=0.5, armature=0.1),
    excitation=FourierTracking(fundamental=0.2, harmonics=10),
    identifier=NullspaceAID(K=20.0, gain=3.0),
    initial_error=0.3,
    duration=20.0,
    dt=2e-3,
)

if __name__ == "__main__":
    main(scenario)
