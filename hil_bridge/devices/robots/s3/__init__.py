"""ABB S3 controller with its computer link."""
