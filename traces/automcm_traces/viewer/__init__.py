"""A run as one HTML page: its data is made here, its JavaScript lies beside.

For ``trace html``.
Commands, reports and maintenance import it.
"""
