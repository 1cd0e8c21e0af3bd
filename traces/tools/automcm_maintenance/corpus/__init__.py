"""Builds traces/corpus: logs, each with its verdict."""
