// Eq. (4-7) for blocks of vertices, one vertex per lane: every vertex sees the same operations in the same order,
// wherever it stands and whatever handles it is bound to beside.

#include "dfd/kernels/falloff.hpp"
#include "dfd/kernels/output.hpp"
#include "dfd/kernels/variants.hpp"

#include <type_traits>

namespace dfd {
namespace {

constexpr std::size_t blocks_ahead = 4;       // of features to prefetch
constexpr std::size_t geodesic_ahead = 1024;  // bytes of each handle's distances to prefetch

// Targets whose sums stay in registers together.
#if defined(__AVX512F__)
constexpr std::size_t tile = 16;
#elif defined(__AVX2__) || defined(__ARM_NEON)
constexpr std::size_t tile = 4;
#else
constexpr std::size_t tile = 2;
#endif
static_assert(group_size % tile == 0);

// Squared distances to `left` targets from `first` on, or to one more: a group of targets ends with zeroes.
template <std::size_t Count, class Panel>
DFD_INLINE void measure(const Panel& panel, const Targets& targets, std::size_t first, std::size_t left, Block* squares)
{
    if constexpr (Count < tile) {
        if (left > Count) return measure<Count == 1 ? 2 : Count + 2>(panel, targets, first, left, squares);
    }
    panel.template squared_distances<Count>(targets, first, squares);
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
                if (largest[part][lane] > limit_bits) result |= geodesic_suspect;
        return result;
    }
};

DFD_INLINE Float load_numbers(const float* from) { return load<Float>(from); }
DFD_INLINE Float load_numbers(const std::uint16_t* from) { return from_halves(from); }

// Equation (7): the weights of one handle times (1 - g)^power for its distances g, of type T.
template <class T>
DFD_INLINE void narrow(const BindJob& job, std::size_t handle, const Place& place, Block& weights, Faults& faults)
{
    const T* distances = static_cast<const T*>(job.geodesic) + handle * job.vertex_count + place.begin;
    prefetch(distances, geodesic_ahead, 1);  // more streams than the machine follows by itself
    T padded[block_size];
    if (place.count < block_size) {
        for (std::size_t lane = 0; lane < block_size; ++lane) padded[lane] = lane < place.count ? distances[lane] : T{};
        distances = padded;
    }
    const auto [power, products] = job.falloffs[handle];
    for (std::size_t part = 0; part < parts; ++part) {
        const Float g = load_numbers(distances + part * width);
        // As whole numbers, the bits of negative numbers and of NaN are beyond those of every valid distance.
        faults.largest[part] = (Bits)g > faults.largest[part] ? (Bits)g : faults.largest[part];
        const Float x = maximum(1.0f - g, splat(0.0f));
        if (products < 0) {
            weights.part[part] *= power_of(x, power);
        } else {
#pragma GCC unroll 1
            for (int k = 0; k < products; ++k) weights.part[part] *= x;
        }
    }
}

// `Columns` and `Distance`, the type of geodesic distances or void, are known to the compiler: what they decide would
// be decided again for every handle of every block.
template <bool Columns, class Distance, class Panel>
DFD_INLINE void bind_block(const BindJob& job, const Panel& panel, const Place& place, float* scratch,
                           LineStream& lines, Faults& faults)
{
    faults.suspect |= panel.suspect();
    Block room;  // what the fixed points leave: 1 less their largest weight
    for (std::size_t part = 0; part < parts; ++part) room.part[part] = splat(1.0f);
    for (std::size_t first = 0; first < job.targets.count; first += tile) {
        const std::size_t left = job.targets.count - first < tile ? job.targets.count - first : tile;
        Block squares[tile];
        measure<1>(panel, job.targets, first, left, squares);
        std::size_t j = 0;
        if (first < job.fixed_count) {  // the nearest one weighs most, so one root serves all
            for (; j < left && first + j < job.fixed_count; ++j)
                for (std::size_t part = 0; part < parts; ++part)
                    room.part[part] = minimum(room.part[part], squares[j].part[part]);
            if (first + j == job.fixed_count)
                for (std::size_t part = 0; part < parts; ++part) room.part[part] = root(room.part[part]);
        }
        for (; j < left; ++j) {
            const std::size_t handle = first + j - job.fixed_count;
            Block weights;
            for (std::size_t part = 0; part < parts; ++part) {
                // The unit that takes roots would hold up all others, so they do every second one.
                const Float square = squares[j].part[part];
                const Float distance = j % 2 == 0 ? root(square) : root_by_products(square);
                weights.part[part] = maximum(room.part[part] - distance, splat(0.0f));  // Equations (4-6)
            }
            if constexpr (!std::is_void_v<Distance>) narrow<Distance>(job, handle, place, weights, faults);
            if constexpr (Columns) {
                put_column(job, handle, place, weights);
            } else {
                for (std::size_t part = 0; part < parts; ++part)
                    store(scratch + handle * block_size + part * width, weights.part[part]);
            }
        }
    }
    if constexpr (!Columns) put_rows(job, place, scratch, lines);
}

template <bool Columns, class Distance, class Read>
DFD_INLINE unsigned bind_blocks(const BindJob& shared_job, std::size_t begin, std::size_t end, float* scratch,
                                const Read& read)
{
    const BindJob job = shared_job;  // which no store can touch
    float* weights = scratch + job.dimension * block_size;
    const bool by_lines = !Columns && job.stream;
    LineStream lines(by_lines ? job.weights + begin * job.row_stride : nullptr, weights + job.handle_count * block_size);
    Faults faults;
    for (std::size_t i = begin; i < end; i += block_size) {
        const std::size_t count = end - i < block_size ? end - i : block_size;
        bind_block<Columns, Distance>(job, read(job, i, count, scratch), {i, count}, weights, lines, faults);
    }
    if (by_lines) lines.finish();
    stream_fence();
    return faults.sum();
}

template <bool Columns, class Read>
DFD_INLINE unsigned bind_lines(const BindJob& job, std::size_t begin, std::size_t end, float* scratch, const Read& read)
{
    if (job.geodesic == nullptr) return bind_blocks<Columns, void>(job, begin, end, scratch, read);
    if (job.geodesic_halves) return bind_blocks<Columns, std::uint16_t>(job, begin, end, scratch, read);
    return bind_blocks<Columns, float>(job, begin, end, scratch, read);
}

// Binds block after block; read(job, first vertex, their number, where to) gives a block's features as a panel.
template <class Read>
DFD_INLINE unsigned bind_range(const BindJob& job, std::size_t begin, std::size_t end, float* scratch, const Read& read)
{
    const bool columns = job.row_stride == 1 && (job.column_stride != 1 || job.handle_count == 1);
    return columns ? bind_lines<true>(job, begin, end, scratch, read) : bind_lines<false>(job, begin, end, scratch, read);
}

}  // namespace

unsigned DFD_VARIANT::bind_rows(const BindJob& job, std::size_t begin, std::size_t end, float* scratch)
{
    return bind_range(job, begin, end, scratch,
                      [](const BindJob& own, std::size_t i, std::size_t count, float* panel) __attribute__((always_inline)) {
        const float* rows = static_cast<const float*>(own.features) + i * own.dimension;
        rows_to_lanes(rows, own.dimension, own.dimension, count, panel);
        return FloatPanel(panel, own.dimension);
    });
}

unsigned DFD_VARIANT::bind_halves(const BindJob& job, std::size_t begin, std::size_t end, float* scratch)
{
    return bind_range(job, begin, end, scratch,
                      [](const BindJob& own, std::size_t i, std::size_t, float* panel) __attribute__((always_inline)) {
        const std::size_t size = own.dimension * block_size;
        const std::uint16_t* halves = static_cast<const std::uint16_t*>(own.features) + i * own.dimension;
        prefetch(halves, blocks_ahead * size * sizeof *halves, size * sizeof *halves);
        for (std::size_t k = 0; k < size; k += width) store(panel + k, from_halves(halves + k));
        return FloatPanel(panel, own.dimension);
    });
}

unsigned DFD_VARIANT::bind_bytes(const BindJob& job, std::size_t begin, std::size_t end, float* scratch)
{
    return bind_range(job, begin, end, scratch,
                      [](const BindJob& own, std::size_t i, std::size_t, float*) __attribute__((always_inline)) {
        const std::uint8_t* bytes = static_cast<const std::uint8_t*>(own.features) + i * (own.dimension + 4);
        const std::size_t size = (own.dimension + 4) * block_size;
        prefetch(bytes, blocks_ahead * size, size);
        return BytePanel(bytes, own.dimension, own.scale);
    });
}

}  // namespace dfd
