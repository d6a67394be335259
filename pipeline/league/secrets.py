"""What a machine of the league may hide: causes of the catalogue in other forms, and others."""

from pipeline.league.known import KNOWN
from pipeline.league.strange import STRANGE

SECRETS = {secret.label: secret for secret in (*KNOWN, *STRANGE)}
