"""ABB S3 controllers with a computer link."""
