"""Arrival times with and without coordination, also in SUMO: section VI-B of the paper."""
