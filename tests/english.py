"""Words that do not occur in German or French texts."""

import re

ENGLISH = re.compile(
    r"\b(the|of|and|is|are|with|to|that|which|reading|pull|joint|below|this|above|when|has)\b"
)
