"""The specification as a package: its vocabulary, its graphs, and TLC, which checks it.

For every other package.
Subpackages, from the bottom: support, vocabulary, graph, model_checking, compilation.
"""
