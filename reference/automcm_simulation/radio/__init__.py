"""Radios in virtual time: tables and ns-3 behind one interface, and a relay for UDP."""
