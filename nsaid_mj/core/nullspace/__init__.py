"""The persistent nullspace P_s(θ) with the only rank decision, and the excitation levels."""
