"""Tools for maintainers: generation, verification, mutation and benchmarks.

They need a clone of the repository and are not in the wheel.
No package of the product imports them; ``automcm_cli.groups`` finds their commands by name.
"""
