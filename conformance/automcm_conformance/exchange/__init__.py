"""One exchange: what is sent, what must be answered, whether it was, and its record.

For the suite, exploration and replays.
Everything above imports it, but for ``vectors``.
"""
