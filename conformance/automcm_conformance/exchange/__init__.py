"""One exchange: its lines, the expected answers, their comparison, and its record.

For the suite, exploration and replays.
Everything above imports it, but for ``vectors``.
"""
