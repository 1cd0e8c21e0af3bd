"""What maintainers of this repository need: it builds and doubts the product.

Needs a clone. The wheel leaves it out.
Nothing of the product imports it; ``automcm_cli.groups`` finds its commands by name.
"""
