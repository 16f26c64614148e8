"""What a video file says of its pictures: read from its header, judged by one table."""
