"""The specification: its vocabulary, the graphs of one station, and model checking with TLC.

Used by every other package. Subpackages, from the bottom: support, vocabulary, model_checking,
graph, compilation.
"""
