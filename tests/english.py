"""Words that no German or French text has."""

import re

ENGLISH = re.compile(
    r"\b(the|of|and|is|are|with|to|that|which|reading|pull|joint|below|this|above|when|has)\b"
)
