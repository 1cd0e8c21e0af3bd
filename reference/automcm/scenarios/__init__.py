"""Scenarios: applications on the MC service.  None of them sees an Ack, and the service looks into
none of their trajectories."""
