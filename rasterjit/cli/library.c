/* The function rasterjit_runs() of every library: it returns 1 if this computer can run the kernels.

   On x86-64, the CPU must have the level LEVEL (2, 3 or 4, as the psABI defines them), and the
   operating system must save its registers. Other CPUs have one level, so they always can.
   ``shared_libraries.py`` compiles this file for any CPU, and links it into each library. Bits of
   CPUID are named as in the manuals of Intel and AMD. */

#ifdef _WIN32
#define EXPORTED __declspec(dllexport)

/* What Microsoft's C library would bring. */

typedef __SIZE_TYPE__ size_t;

int _fltused;

void *memset(void *first, int value, size_t count) {
#ifdef __x86_64__
    void *at = first;
    __asm__ volatile("rep stosb" : "+D"(at), "+c"(count) : "a"(value) : "memory");
#else
    /* The empty lines of assembly keep the compiler from calling memset for these loops. */
    unsigned long long all = 0x0101010101010101ull * (unsigned char)value;
    char *at = first, *end = at + count;
    for (; end - at >= 8; at += 8) {
        __builtin_memcpy(at, &all, 8);
        __asm__ volatile("" ::: "memory");
    }
    for (; at < end; at++) {
        *at = (char)value;
        __asm__ volatile("" ::: "memory");
    }
#endif
    return first;
}
#else
#define EXPORTED
#endif

#ifdef __x86_64__

struct registers { unsigned eax, ebx, ecx, edx; };

static struct registers cpuid(unsigned leaf) {
    struct registers r;
    __asm__ volatile("cpuid" : "=a"(r.eax), "=b"(r.ebx), "=c"(r.ecx), "=d"(r.edx) : "a"(leaf), "c"(0));
    return r;
}

/* Parts of the registers that the system saves: 0x6 those of AVX, 0xe6 of AVX-512, too. */
static unsigned saved(void) {
    unsigned low, high;
    __asm__ volatile("xgetbv" : "=a"(low), "=d"(high) : "c"(0));
    return low;
}

#define BIT(n) (1u << (n))
#define HAS(value, wanted) (((value) & (wanted)) == (wanted))

static int level(void) {
    unsigned most = cpuid(0).eax;
    struct registers one = cpuid(1), seven = {0}, more = {0};
    if (most >= 7) seven = cpuid(7);
    if (cpuid(0x80000000u).eax >= 0x80000001u) more = cpuid(0x80000001u);

    /* SSE3, SSSE3, CMPXCHG16B, SSE4.1, SSE4.2, POPCNT; LAHF. */
    if (!HAS(one.ecx, BIT(0) | BIT(9) | BIT(13) | BIT(19) | BIT(20) | BIT(23))) return 1;
    if (!HAS(more.ecx, BIT(0))) return 1;

    /* FMA, MOVBE, XSAVE, OSXSAVE, AVX, F16C; BMI1, AVX2, BMI2; LZCNT. */
    if (!HAS(one.ecx, BIT(12) | BIT(22) | BIT(26) | BIT(27) | BIT(28) | BIT(29))) return 2;
    if (!HAS(seven.ebx, BIT(3) | BIT(5) | BIT(8)) || !HAS(more.ecx, BIT(5))) return 2;
    if (!HAS(saved(), 0x6)) return 2;

    /* AVX-512: F, DQ, CD, BW, VL. */
    if (!HAS(seven.ebx, BIT(16) | BIT(17) | BIT(28) | BIT(30) | BIT(31))) return 3;
    return HAS(saved(), 0xe6) ? 4 : 3;
}

EXPORTED int rasterjit_runs(void) { return level() >= LEVEL; }

#else

EXPORTED int rasterjit_runs(void) { return 1; }

#endif
