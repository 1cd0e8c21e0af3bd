"""How often does an exchange succeed if messages are lost? Section IV of the paper.

Sessions, drives, and UDP between processes.
Only ``runs`` imports it.
"""
