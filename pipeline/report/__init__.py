"""The report on a campaign, as a web page and as a PDF."""
