"""The room of the ABB S3 controller and its computer link."""
