// Eq. (4-7) for blocks of vertices, one vertex per lane: every vertex sees the same operations in the same order,
// wherever it stands and whatever handles it is bound to beside.

#include "dfd/kernels/simd.hpp"
#include "dfd/kernels/variants.hpp"

namespace dfd {
namespace {

constexpr std::size_t width = lanes<float>;
constexpr std::size_t parts = vectors<float>;
constexpr std::size_t chunk = 128;              // entries summed before the sum joins the total
constexpr std::size_t geodesic_ahead = 1024;    // bytes of each handle's distances to prefetch
constexpr float geodesic_slack = 1e-5f;         // what rounding may add to the largest distance

// Handles whose sums stay in registers together.
#if defined(__AVX512F__)
constexpr std::size_t tile = 16;
#elif defined(__AVX2__) || defined(__ARM_NEON)
constexpr std::size_t tile = 4;
#else
constexpr std::size_t tile = 2;
#endif

// One number of each vertex of a block.
struct Block {
    Float part[parts];
};

// The sum of `size` terms in four strands, so that no addition waits for the one before.
template <class Add>
DFD_INLINE Float sum_of(std::size_t size, const Add& add)
{
    Float a{}, b{}, c{}, d{};
    std::size_t k = 0;
    for (; k + 4 <= size; k += 4) {
        a = add(k, a);
        b = add(k + 1, b);
        c = add(k + 2, c);
        d = add(k + 3, d);
    }
    for (; k < size; ++k) a = add(k, a);
    return (a + b) + (c + d);
}

// Squared distances by |a|² + |b|² - 2 a·b at the speed of a matrix product. Where cancellation would cost digits
// that a weight shows, they are taken again from the differences.
class FloatPanel {
public:
    FloatPanel(const float* panel, std::size_t dimension) : panel_(panel), dimension_(dimension)
    {
        for (std::size_t part = 0; part < parts; ++part) {
            square_.part[part] = sum_of(dimension, [&](std::size_t k, Float sum) __attribute__((always_inline)) {
                const Float entry = load<Float>(panel + k * block_size + part * width);
                return fused(entry, entry, sum);
            });
        }
    }

    bool suspect() const
    {
        Float zero{};  // becomes NaN unless all are finite
        for (std::size_t part = 0; part < parts; ++part) zero += square_.part[part] - square_.part[part];
        return !all(equal(zero, zero));
    }

    template <std::size_t Count>
    DFD_INLINE void squared_distances(const Targets& targets, std::size_t first, Block* out) const
    {
        const float* rows = targets.rows + first / group_size * group_size * dimension_ + first % group_size;
        Float total[Count][parts] = {};
        for (std::size_t start = 0; start < dimension_; start += chunk) {
            const std::size_t end = start + chunk < dimension_ ? start + chunk : dimension_;
            Float sum[Count][parts] = {};
            for (std::size_t k = start; k < end; ++k) {
                Float entry[parts];
                for (std::size_t part = 0; part < parts; ++part)
                    entry[part] = load<Float>(panel_ + k * block_size + part * width);
#pragma GCC unroll 16
                for (std::size_t j = 0; j < Count; ++j) {
                    const Float other = splat(rows[k * group_size + j]);
                    for (std::size_t part = 0; part < parts; ++part)
                        sum[j][part] = fused(entry[part], other, sum[j][part]);
                }
            }
#pragma GCC unroll 16
            for (std::size_t j = 0; j < Count; ++j)
                for (std::size_t part = 0; part < parts; ++part) total[j][part] += sum[j][part];
        }
        for (std::size_t j = 0; j < Count; ++j) {
            for (std::size_t part = 0; part < parts; ++part) {
                const Float squares = square_.part[part] + splat(targets.squares[first + j]);
                Float square = fused(splat(-2.0f), total[j][part], squares);
                // An error of 2e-7 (|a|² + |b|²) in the square stays below 2e-6 in the distance above this bound;
                // beyond a distance of 1 it is never seen.
                const Float bound = minimum(0.005f * squares * squares, 1.0f + 1e-6f * squares);
                const auto far = at_least(square, bound);
                if (!all(far)) square = select(far, square, squared_difference(rows + j, part));
                out[j].part[part] = square + splat(targets.offsets[first + j]);
            }
        }
    }

private:
    Float squared_difference(const float* row, std::size_t part) const
    {
        return sum_of(dimension_, [&](std::size_t k, Float sum) __attribute__((always_inline)) {
            const Float difference = load<Float>(panel_ + k * block_size + part * width) - splat(row[k * group_size]);
            return fused(difference, difference, sum);
        });
    }

    const float* panel_;
    std::size_t dimension_;
    Block square_{};
};

// Squared distances of int8 entries: whole numbers, hence exact.
class BytePanel {
public:
    BytePanel(const std::uint8_t* panel, std::size_t dimension, float scale)
        : panel_(panel), quads_(dimension / 4), scale_(scale)
    {
    }

    bool suspect() const { return false; }

    template <std::size_t Count>
    DFD_INLINE void squared_distances(const Targets& targets, std::size_t first, Block* out) const
    {
        const std::int32_t* quads = targets.quads + first / group_size * group_size * quads_ + first % group_size;
        Int sum[Count][parts] = {};
#pragma GCC unroll 4
        for (std::size_t k = 0; k < quads_; ++k) {
            Int entry[parts];
            for (std::size_t part = 0; part < parts; ++part)
                entry[part] = load<Int>(panel_ + (k * block_size + part * width) * 4);
#pragma GCC unroll 16
            for (std::size_t j = 0; j < Count; ++j) {
                const Int other = splat(quads[k * group_size + j]);
                for (std::size_t part = 0; part < parts; ++part)
                    sum[j][part] = dot4(sum[j][part], entry[part], other);
            }
        }
#pragma GCC unroll 16
        for (std::size_t j = 0; j < Count; ++j) {
            for (std::size_t part = 0; part < parts; ++part) {
                const Int own = load<Int>(panel_ + (quads_ * block_size + part * width) * 4);
                const Int square = own + targets.quad_squares[first + j] - 2 * sum[j][part];
                out[j].part[part] = fused(__builtin_convertvector(square, Float), splat(scale_ * scale_),
                                          splat(targets.offsets[first + j]));
            }
        }
    }

private:
    const std::uint8_t* panel_;
    std::size_t quads_;
    float scale_;
};

// 2^x for x <= 0 by its series about the nearest whole number, exact at 0.
DFD_INLINE Float exp2_of(Float x)
{
    x = maximum(x, splat(-126.0f));
    const Int whole = __builtin_convertvector(x - 0.5f, Int);
    const Float f = x - __builtin_convertvector(whole, Float);
    Float y = splat(1.5403530e-4f);
    y = fused(y, f, splat(1.3333558e-3f));
    y = fused(y, f, splat(9.6181291e-3f));
    y = fused(y, f, splat(5.5504109e-2f));
    y = fused(y, f, splat(2.4022651e-1f));
    y = fused(y, f, splat(6.9314718e-1f));
    y = fused(y, f, splat(1.0f));
    return (Float)((Int)y + (whole << 23));
}

// log2 of x in (0, 1], exact at 1: x = m 2^e with m in [sqrt(1/2), sqrt(2)), and the odd series of log((1+s)/(1-s)).
DFD_INLINE Float log2_of(Float x)
{
    const Int bits = (Int)x - 0x3f3504f3;
    const Int exponent = bits >> 23;
    const Float m = (Float)((bits & 0x7fffff) + 0x3f3504f3);
    const Float s = (m - 1.0f) / (m + 1.0f);
    const Float q = s * s;
    Float y = splat(0.32059890f);
    y = fused(y, q, splat(0.41219859f));
    y = fused(y, q, splat(0.57707802f));
    y = fused(y, q, splat(0.96179669f));
    y = fused(y, q, splat(2.8853901f));
    return fused(y, s, __builtin_convertvector(exponent, Float));
}

// (1 - g)^power, Equation (7). Whole powers up to 4, the usual ones, need no logarithm.
DFD_INLINE Float falloff(Float g, float power)
{
    const Float x = maximum(1.0f - g, splat(0.0f));
    if (power == 0) return splat(1.0f);
    if (power == 1) return x;
    if (power == 2) return x * x;
    if (power == 3) return x * x * x;
    if (power == 4) return (x * x) * (x * x);
    const Float positive = exp2_of(power * log2_of(maximum(x, splat(0x1p-126f))));
    return select(at_least(splat(0.0f), x), splat(0.0f), positive);
}

// Calls visit(j, squared distances of target j) for every target of the panel.
template <std::size_t Count, class Panel, class Visit>
DFD_INLINE void visit_tile(const Panel& panel, const Targets& targets, std::size_t first, const Visit& visit)
{
    Block squares[Count];
    panel.template squared_distances<Count>(targets, first, squares);
    for (std::size_t j = 0; j < Count; ++j) visit(first + j, squares[j]);
}

template <class Panel, class Visit>
DFD_INLINE void for_each_target(const Panel& panel, const Targets& targets, const Visit& visit)
{
    std::size_t j = 0;
    for (; j + tile <= targets.count; j += tile) visit_tile<tile>(panel, targets, j, visit);
    if constexpr (tile > 8)
        if (j + 8 <= targets.count) visit_tile<8>(panel, targets, j, visit), j += 8;
    if constexpr (tile > 4)
        if (j + 4 <= targets.count) visit_tile<4>(panel, targets, j, visit), j += 4;
    if constexpr (tile > 2)
        if (j + 2 <= targets.count) visit_tile<2>(panel, targets, j, visit), j += 2;
    if (j < targets.count) visit_tile<1>(panel, targets, j, visit);
}

DFD_INLINE Float weight(Float square)  // Equations (4) and (5)
{
    return maximum(1.0f - root(maximum(square, splat(0.0f))), splat(0.0f));
}

// Copies past the caches, but for the parts of lines at either end.
DFD_INLINE void stream_out(const float* from, std::size_t count, float* to)
{
    const std::size_t head = (0 - reinterpret_cast<std::uintptr_t>(to)) % 64 / sizeof(float);
    std::size_t k = 0;
    for (; k < head && k < count; ++k) to[k] = from[k];
    for (; k + width <= count; k += width) stream(to + k, load<Float>(from + k));
    for (; k < count; ++k) to[k] = from[k];
}

typedef std::uint32_t Bits __attribute__((vector_size(vector_bytes)));

// What a range has met.
struct Faults {
    bool suspect = false;
    Bits largest[parts] = {};  // bits of geodesic distances

    unsigned sum() const
    {
        const float limit = 1.0f + geodesic_slack;
        std::uint32_t limit_bits;
        std::memcpy(&limit_bits, &limit, sizeof limit);
        unsigned result = suspect ? features_suspect : no_fault;
        for (std::size_t part = 0; part < parts; ++part)
            for (std::size_t lane = 0; lane < width; ++lane)
                if (largest[part][lane] > limit_bits) result |= geodesic_invalid;
        return result;
    }
};

template <class Panel>
DFD_INLINE void bind_block(const BindJob& job, const Panel& panel, std::size_t begin, std::size_t count, float* scratch,
                           Faults& faults)
{
    faults.suspect |= panel.suspect();
    Block held{};
    for_each_target(panel, job.fixed, [&](std::size_t, const Block& squares) __attribute__((always_inline)) {
        for (std::size_t part = 0; part < parts; ++part)
            held.part[part] = maximum(held.part[part], weight(squares.part[part]));
    });

    const bool columns = job.row_stride == 1 && (job.column_stride != 1 || job.handles.count == 1);
    for_each_target(panel, job.handles, [&](std::size_t j, const Block& squares) __attribute__((always_inline)) {
        Block result;
        for (std::size_t part = 0; part < parts; ++part)
            result.part[part] = maximum(weight(squares.part[part]) - held.part[part], splat(0.0f));  // Equation (6)
        if (job.geodesic != nullptr) {
            const float* distances = job.geodesic + j * job.vertex_count + begin;
            prefetch(distances, geodesic_ahead, 1);  // more streams than the machine follows by itself
            float padded[block_size] = {};
            if (count < block_size) {
                for (std::size_t lane = 0; lane < count; ++lane) padded[lane] = distances[lane];
                distances = padded;
            }
            for (std::size_t part = 0; part < parts; ++part) {
                const Float g = load<Float>(distances + part * width);
                // As whole numbers, the bits of negative numbers and of NaN are beyond those of every valid distance.
                const Bits bits = (Bits)(g + 0.0f);
                faults.largest[part] = bits > faults.largest[part] ? bits : faults.largest[part];
                result.part[part] *= falloff(g, job.locality[j]);
            }
        }
        float* column = job.weights + begin + j * job.column_stride;
        if (!columns) {
            for (std::size_t part = 0; part < parts; ++part)
                store(scratch + j * block_size + part * width, result.part[part]);
        } else if (count < block_size) {
            float padded[block_size];
            for (std::size_t part = 0; part < parts; ++part) store(padded + part * width, result.part[part]);
            for (std::size_t lane = 0; lane < count; ++lane) column[lane] = padded[lane];
        } else {
            for (std::size_t part = 0; part < parts; ++part) {
                if (job.stream) stream(column + part * width, result.part[part]);
                else store(column + part * width, result.part[part]);
            }
        }
    });
    if (columns) return;

    float* rows = job.weights + begin * job.row_stride;
    if (job.stream && count == block_size) {  // the block's rows follow one another, so they leave as whole lines
        float* assembled = scratch + (job.handles.count + group_size) * block_size;
        lanes_to_rows(scratch, job.handles.count, assembled, job.handles.count, count);
        stream_out(assembled, job.handles.count * block_size, rows);
    } else {
        lanes_to_rows(scratch, job.handles.count, rows, job.row_stride, count);
    }
}

std::size_t block_count(std::size_t begin, std::size_t end) { return end - begin < block_size ? end - begin : block_size; }

}  // namespace

unsigned DFD_VARIANT::bind_rows(const BindJob& shared_job, std::size_t begin, std::size_t end, float* scratch)
{
    const BindJob job = shared_job;  // which no store can touch
    Faults faults;
    float* panel = scratch;
    for (std::size_t i = begin; i < end; i += block_size) {
        const std::size_t count = block_count(i, end);
        rows_to_lanes(static_cast<const float*>(job.features) + i * job.dimension, job.dimension, job.dimension, count,
                      panel);
        bind_block(job, FloatPanel(panel, job.dimension), i, count, scratch + job.dimension * block_size,
                   faults);
    }
    stream_fence();
    return faults.sum();
}

unsigned DFD_VARIANT::bind_halves(const BindJob& shared_job, std::size_t begin, std::size_t end, float* scratch)
{
    const BindJob job = shared_job;  // which no store can touch
    Faults faults;
    float* panel = scratch;
    const std::size_t size = job.dimension * block_size;
    for (std::size_t i = begin; i < end; i += block_size) {
        const std::uint16_t* halves = static_cast<const std::uint16_t*>(job.features) + i / block_size * size;
        for (std::size_t k = 0; k < size; k += width) store(panel + k, from_halves(halves + k));
        bind_block(job, FloatPanel(panel, job.dimension), i, block_count(i, end), scratch + size, faults);
    }
    stream_fence();
    return faults.sum();
}

unsigned DFD_VARIANT::bind_bytes(const BindJob& shared_job, std::size_t begin, std::size_t end, float* scratch)
{
    const BindJob job = shared_job;  // which no store can touch
    Faults faults;
    const std::size_t size = (job.dimension + 4) * block_size;
    for (std::size_t i = begin; i < end; i += block_size) {
        const std::uint8_t* bytes = static_cast<const std::uint8_t*>(job.features) + i / block_size * size;
        bind_block(job, BytePanel(bytes, job.dimension, job.scale), i, block_count(i, end), scratch, faults);
    }
    stream_fence();
    return faults.sum();
}

}  // namespace dfd
