"""The command ``automcm``.

It holds the commands only; the packages that it imports do the work.
No package of the product imports it.
"""
