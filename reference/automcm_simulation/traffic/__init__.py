"""Stations in traffic: SUMO moves everybody, and each equipped vehicle has a service.

The skeleton of all scenarios: mover, radio, perception, logs and measures.
Only ``traffic_scenarios`` and the commands import it.
"""
