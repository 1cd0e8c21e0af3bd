"""The command ``automcm``.

Commands only: what they do is in the packages below.
Nothing of the product imports it.
"""
