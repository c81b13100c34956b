"""What nodes share: parameters, executors and stopping, messages, the head."""
