"""TLC: downloads it, runs the models of spec/models, and interprets the results.

Used by the commands ``spec`` and ``verify``. Needs the extra ``tlc``; code that runs without Java
does not import it.
"""
