"""Links: what carries encoded messages from one service to others.

UDP, a relay that loses packets, a simulated radio, and their clocks.
The service and the scenarios import it; it imports the messages alone.
"""
