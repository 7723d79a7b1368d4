"""Which physical effect is missing: evidence, search for explanations, adequacy, verdict, next test."""
