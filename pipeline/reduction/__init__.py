"""From the files of a campaign to forces and displacements in F_b."""
