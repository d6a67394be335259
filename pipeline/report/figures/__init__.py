"""The pictures: each draws what its caption in captions.py speaks of, from the same digest."""
