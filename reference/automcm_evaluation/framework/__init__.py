"""The framework of the experiments: settings, independent cells, claims, intervals."""
