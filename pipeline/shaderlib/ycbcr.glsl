// Y'CbCr and back. Twin: colour.py.

// Columns are what red, green and blue contribute (BT.709, full range).
const mat3 YCBCR_FROM_RGB = mat3(0.2126, -0.2126 / 1.8556, 0.5,
                                 0.7152, -0.7152 / 1.8556, -0.7152 / 1.5748,
                                 0.0722, 0.5, -0.0722 / 1.5748);

// Columns are what Y', Cb and Cr contribute.
const mat3 RGB_FROM_YCBCR = mat3(1.0, 1.0, 1.0,
                                 0.0, -0.0722 * 1.8556 / 0.7152, 1.8556,
                                 1.5748, -0.2126 * 1.5748 / 0.7152, 0.0);
