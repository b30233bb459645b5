"""Constants of real spherical harmonics, in the sign convention of 3DGS. No torch."""

SH_DEGREE_0 = 0.28209479177387814  # Y_0^0; colour = 0.5 + SH_DEGREE_0 * harmonics[0]
SH_DEGREE_1 = 0.4886025119029199  # the basis is -SH_DEGREE_1 y, SH_DEGREE_1 z, -SH_DEGREE_1 x at a unit direction
