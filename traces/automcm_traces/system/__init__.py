"""Several logs of one run: merged, with aligned clocks, and checked for the S and T properties.

Used by ``explain`` with more than one log.
The subpackages explain, edit, export and viewer import it.
"""
