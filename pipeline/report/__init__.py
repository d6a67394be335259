"""What is said about a campaign, as a page and as a PDF."""
