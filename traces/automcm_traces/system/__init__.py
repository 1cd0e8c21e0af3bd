"""Several logs of one run: merged, clocks aligned, S and T properties checked.

For ``explain`` with more than one log.
explain, edit, export and viewer import it.
"""
