"""The nodes that turn a head, head_tracker and point_head, and what drives its joints."""
