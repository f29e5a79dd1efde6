"""Motor gains assumed 20 % wrong: conventional identification fails, NS-AID is not affected."""

from nsaid_mj import ArmPlant, ConventionalAID, FourierTracking, NullspaceAID, Scenario, main

scenario = Scenario(
    plant=ArmPlant(robot="double_pendulum", damping=0.1, friction=0.2, armature=0.01),
    excitation=FourierTracking(fundamental=0.3, harmonics=5, speed=6.0),
    identifier=NullspaceAID(K=20.0, gain=8.0),
    rivals={"conventional": ConventionalAID(K=20.0, gain=8.0, known=("actuators",))},
    initial_error=0.3,
    gain_error=0.2,
    duration=120.0,
)

if __name__ == "__main__":
    main(scenario)
