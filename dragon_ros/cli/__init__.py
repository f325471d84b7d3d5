"""Parts that all command lines share: options, errors, completion, figures and signals."""
