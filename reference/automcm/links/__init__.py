"""Links carry encoded messages from one service to others.

UDP, a lossy relay, a simulated radio, and their clocks.
The service and the scenarios import it; it imports only the messages.
"""
