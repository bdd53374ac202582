"""Operations on device arrays, in OpenCL: nothing here knows what a sonar is."""
