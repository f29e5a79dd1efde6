"""Go2 on the ground: squats, a trot, and waving a leg; the forces on its feet are not measured."""

from nsaid_mj import NullspaceAID, Scenario, Walk, WalkingPlant, main

scenario = Scenario(
    plant=WalkingPlant(robot="go2", damping=0.1, friction=0.2, armature=0.012),
    excitation=Walk(stance=(0.0, 0.8, -1.6)),
    identifier=NullspaceAID(law="memory"),
    initial_error=0.3,
    duration=60.0,
    dt=2e-3,  # the robot's own interface runs at 500 Hz
    substeps=2,
    held_out=15.0,  # one round of the motion
)

if __name__ == "__main__":
    main(scenario)
