"""Mutation fuzzer: files and settings of a campaign are spoilt, and a judge assesses the result.

The mutations know the documented formats but not the code. A spoilt campaign may be rejected in one
sentence, read as before, or answered with a warning; nothing else is allowed.
"""
