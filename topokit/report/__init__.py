"""From measurements to a report: evidence, verdict and wording."""
