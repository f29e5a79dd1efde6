"""One robot's equations as data, and the kernels that evaluate them. No MuJoCo, no true value."""
