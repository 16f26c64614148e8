"""The steerable pyramid: what an image holds, by scale and orientation."""
