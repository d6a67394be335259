"""The mutation fuzzer: files and settings of a campaign are spoilt, and a judge says what came.

The mutations know the documented formats and nothing of the code. A campaign that was spoilt may be
rejected in one sentence, read as before, or answered with something said; never anything else.
"""
