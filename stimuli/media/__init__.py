"""Files of pictures and clips: channels, planes, flow, frames and videos."""
