"""Any robot of example-robot-data, or a URDF file, as an arm: `nsaid run arm --robot NAME`."""

from nsaid_mj import ArmPlant, FourierTracking, NullspaceAID, Scenario, main

scenario = Scenario(
    plant=ArmPlant(robot="xarm7"),
    excitation=FourierTracking(fundamental=0.2, harmonics=10),
    identifier=NullspaceAID(K=20.0, gain=0.3),
    initial_error=0.3,
    duration=20.0,
)

if __name__ == "__main__":
    main(scenario)
