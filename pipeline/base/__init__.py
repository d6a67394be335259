"""Common ground of all packages: arrays, errors, files, covariances."""
