"""Legs of a G1 on flat feet: squats, and the weight on one leg after the other, which is lifted."""

from nsaid_mj import NullspaceAID, Scenario, Walk, WalkingPlant, main

scenario = Scenario(
    plant=WalkingPlant(
        robot="g1_legs",
        feet="_ankle_roll_link",
        sole=(0.035, 0.03, 0.16, 0.09),  # wider than the robot's: it balances without feedback
        damping=0.2,
        friction=0.3,
        armature=0.03,
    ),
    excitation=Walk(
        stance=(-0.3, 0.0, 0.0, 0.6, -0.3, 0.0),
        squat=5.0,
        trot=0.0,
        wave=11.0,
        ramp=2.0,
        depth=0.04,
        sway=0.01,
        tilt=0.04,
        lean=0.9,
        reach=0.03,
        stiffness=6.0,
        damping=0.012,
    ),
    identifier=NullspaceAID(law="memory"),
    initial_error=0.3,
    duration=60.0,
    dt=1e-3,
    held_out=16.0,  # one round of the motion
)

if __name__ == "__main__":
    main(scenario)
