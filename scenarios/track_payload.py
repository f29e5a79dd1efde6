"""Adaptive tracking: a UR5 picks up 1 kg while it follows a trajectory, and releases it later."""

from nsaid_mj import AdaptiveTracking, ArmPlant, NullspaceAID, Payload, Scenario, main

scenario = Scenario(
    plant=ArmPlant(
        robot="ur5",
        damping=2.0,
        friction=1.0,
        armature=0.1,
        faults=(Payload(mass=1.0, place=(0.0, 0.0823, 0.0), time=15.0, until=30.0),),
    ),
    excitation=AdaptiveTracking(fundamental=0.2, harmonics=8, speed=2.5),
    identifier=NullspaceAID(K=20.0, gain=0.3, law="efficient"),
    initial_error=0.4,
    gain_error=0.4,
    duration=45.0,
    dt=1e-3,
)

if __name__ == "__main__":
    main(scenario)
