"""Secrets of the machines: causes of the catalogue in other forms, and others."""

from bench.league.in_catalogue import KNOWN, LATER
from bench.league.outside_catalogue import STRANGE

SECRETS = {secret.label: secret for secret in (*KNOWN, *LATER, *STRANGE)}
