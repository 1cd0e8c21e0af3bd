"""The kernels computed a second time, exactly, for the expected outputs of the test vectors."""
