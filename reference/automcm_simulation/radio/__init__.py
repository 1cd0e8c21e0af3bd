"""Radios in virtual time: tables and ns-3 behind one interface, a relay for UDP, and how often
a session succeeds.
"""
