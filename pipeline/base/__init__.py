"""What every other package uses: arrays, errors, files, covariances."""
