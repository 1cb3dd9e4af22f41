"""Computer link of the ABB S3: link layer (ADLP), application layer (ARAP) and timing."""
