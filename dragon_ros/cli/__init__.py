"""What all command lines share: options, errors, completion, figures, signals."""
