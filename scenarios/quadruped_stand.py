"""Go2 on a stand: its legs move in the air, and each keeps a scale of its own."""

from nsaid_mj import ArmPlant, FourierTracking, NullspaceAID, Scenario, main

scenario = Scenario(
    plant=ArmPlant(robot="go2", damping=0.1, friction=0.2, armature=0.012),
    excitation=FourierTracking(fundamental=0.2, harmonics=10, speed=5.0),
    identifier=NullspaceAID(law="memory"),
    initial_error=0.3,
    duration=60.0,
    dt=2e-3,
)

if __name__ == "__main__":
    main(scenario)
