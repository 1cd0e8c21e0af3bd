"""Roads, vehicles, radios and traffic in a computer, for stations of the reference.

Product: `automcm demo`, `drive` and `simulate`.  See docs/reference.md.
"""
