"""A station behind its adapter: the process, the lines, their schema, templates.

For everything that talks to a station under test.
The other subpackages import it; it imports none of them.
"""
