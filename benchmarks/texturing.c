/* Fill a picture with a plane under a texture: what `texturing` measures RasterJIT against. */

#include <math.h>
#include <stdint.h>
#include <string.h>

typedef float vec4 __attribute__((vector_size(16)));

enum { RUN = 256 };

static vec4 texel(const float *texels, int32_t number) {
    vec4 found;
    memcpy(&found, texels + 4 * (int64_t)number, sizeof found);
    return found;
}

static vec4 mix(vec4 one, vec4 other, float share) {
    return one + share * (other - one);
}

/* Encode a linear value as sRGB: see rasterjit.pipeline.srgb_encoding. */
static uint32_t encode(float value, const int32_t *table) {
    uint32_t bits;
    memcpy(&bits, &value, sizeof bits);
    return ((uint32_t)table[bits >> 16] + (bits & 0xffff)) >> 16 & 255;
}

/*
 * Write all pixels, one thread.
 *
 * plane: rows of a matrix that (column, row, 1) of a pixel's centre is multiplied by: u, v, in
 * texels and times w, and w. The picture's sides are powers of two. Texels are linear RGBA, row by
 * row from the bottom. Half a texel is subtracted already where is_smooth.
 */
void fill(uint32_t *pixels, int width, int height, const float *plane, const float *texels,
          int columns, int rows, const int32_t *table, int is_smooth) {
    static float along[RUN], upward[RUN], light[3][RUN];
    static int32_t numbers[4][RUN];
    const int32_t right = columns - 1, top = rows - 1;
    for (int y = 0; y < height; y++) {
        for (int begin = 0; begin < width; begin += RUN) {
            const int count = width - begin < RUN ? width - begin : RUN;
            const float down = y + 0.5f;
            const float u0 = plane[1] * down + plane[2], v0 = plane[4] * down + plane[5];
            const float w0 = plane[7] * down + plane[8];
            for (int n = 0; n < count; n++) {
                const float x = begin + n + 0.5f, over = 1.0f / (plane[6] * x + w0);
                const float u = (plane[0] * x + u0) * over, v = (plane[3] * x + v0) * over;
                const float left = floorf(u), low = floorf(v);
                const int32_t i = (int32_t)left, j = (int32_t)low;
                along[n] = u - left, upward[n] = v - low;
                numbers[0][n] = (j & top) * columns + (i & right);
                numbers[1][n] = (j & top) * columns + (i + 1 & right);
                numbers[2][n] = (j + 1 & top) * columns + (i & right);
                numbers[3][n] = (j + 1 & top) * columns + (i + 1 & right);
            }
            for (int n = 0; n < count; n++) {
                vec4 color = texel(texels, numbers[0][n]);
                if (is_smooth) {
                    const vec4 lower = mix(color, texel(texels, numbers[1][n]), along[n]);
                    const vec4 upper = mix(texel(texels, numbers[2][n]),
                                           texel(texels, numbers[3][n]), along[n]);
                    color = mix(lower, upper, upward[n]);
                }
                for (int k = 0; k < 3; k++) light[k][n] = color[k];
            }
            uint32_t *own = pixels + (int64_t)y * width + begin;
            for (int n = 0; n < count; n++) {
                own[n] = 0xff000000u | encode(light[0][n], table)
                    | encode(light[1][n], table) << 8 | encode(light[2][n], table) << 16;
            }
        }
    }
}
