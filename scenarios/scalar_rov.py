"""The 1-DOF vehicle of equation (16): an ROV's heave axis, one thruster of unknown gain."""

from nsaid_mj import MultisineCommand, NullspaceAID, ScalarRovPlant, Scenario, main

scenario = Scenario(
    plant=ScalarRovPlant(),
    excitation=MultisineCommand(low=0.1, high=1.0, tones=8, amplitude=0.4),
    identifier=NullspaceAID(K=10.0, gain=0.3),
    initial_error=0.5,
    duration=120.0,
    dt=0.01,
    pe_window=20.0,
    held_out=30.0,
)

if __name__ == "__main__":
    main(scenario)
