"""UR5, gently: the three joints of the wrist, then all six."""

from nsaid_mj import ArmPlant, FourierTracking, NullspaceAID, Phase, Scenario, Sequence, main

scenario = Scenario(
    plant=ArmPlant(robot="ur5", damping=2.0, friction=1.0, armature=0.1),
    excitation=Sequence(
        phases={
            "wrist": Phase(
                FourierTracking(fundamental=0.2, harmonics=10, speed=3.0, joints=(4, 5, 6)), 10.0
            ),
            "all": Phase(FourierTracking(fundamental=0.2, harmonics=10, speed=3.0), 10.0),
        },
        blend=2.0,
    ),
    identifier=NullspaceAID(K=20.0, gain=0.3, rate=2.0, law="memory"),
    initial_error=0.3,
    duration=20.0,
    dt=2e-3,
    held_out=20.0,
)

if __name__ == "__main__":
    main(scenario)
