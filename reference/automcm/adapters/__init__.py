"""The reference behind the kit's adapter protocol, by which the kit reaches a station."""
