"""What every room stands on: paths, files, errors, numbers, words, colours, schemas."""
