"""A station behind its adapter: the process, the lines, their schema, templates.

Used by everything that talks to a station under test.
The other subpackages import this one; it imports none of them.
"""
