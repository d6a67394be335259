"""Reference campaigns with certified answers, in the manner of NIST's StRD; docs/reference.md."""
