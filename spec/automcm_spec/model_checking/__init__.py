"""TLC: fetches it, runs the models of spec/models, and reads what it found.

For the commands ``spec`` and ``verify``, and for the log tools' second engine.
Needs the extra ``tlc``; whatever runs without Java does not import it.
"""
