"""What `import pipeline` offers; names come from here when they are asked for."""
