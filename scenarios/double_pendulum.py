"""A double pendulum: two motors of unknown gain move two links of unknown inertia."""

from nsaid_mj import ArmPlant, FourierTracking, NullspaceAID, Scenario, main

scenario = Scenario(
    plant=ArmPlant(robot="double_pendulum"),
    excitation=FourierTracking(fundamental=0.2, harmonics=5),
    identifier=NullspaceAID(K=20.0, gain=10.0),
    initial_error=0.3,
    duration=120.0,
)

if __name__ == "__main__":
    main(scenario)
