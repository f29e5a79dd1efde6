"""Servo arm: three position servos of unknown stiffness follow targets; no torque is measured."""

from nsaid_mj import ArmPlant, MultisineCommand, NullspaceAID, Scenario, main

scenario = Scenario(
    plant=ArmPlant(
        robot="servo_arm", actuator="servo", gain=8.0, damping=0.3, friction=0.05, armature=0.02
    ),
    excitation=MultisineCommand(low=0.1, high=2.0, tones=8, amplitude=0.9),
    identifier=NullspaceAID(K=20.0, gain=1.0, floor=1e-3),
    initial_error=0.3,
    duration=60.0,
    dt=2e-3,
)

if __name__ == "__main__":
    main(scenario)
