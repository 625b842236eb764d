// Lists, sorting, vectors and poses: all that the kernel needs, so that it links against no C++ library.
#pragma once
#include <math.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

inline void* operator new(size_t, void* place) noexcept { return place; }

constexpr double ENDLESS = 1e300;  // larger than every length and every factor of a ray

template <class T> T least(T a, T b) { return b < a ? b : a; }
template <class T> T most(T a, T b) { return a < b ? b : a; }
template <class T> void swap(T& a, T& b) { T kept = a; a = b, b = kept; }

// A growing array. Elements move as bytes: none may hold an address inside itself.
template <class T> class List {
    T* data_ = nullptr;
    int size_ = 0, room_ = 0;

public:
    List() = default;
    List(const List&) = delete;
    List& operator=(const List&) = delete;
    ~List() { clear(); free(data_); }
    int size() const { return size_; }
    bool empty() const { return size_ == 0; }
    T* begin() { return data_; }
    T* end() { return data_ + size_; }
    const T* begin() const { return data_; }
    const T* end() const { return data_ + size_; }
    T& operator[](int i) { return data_[i]; }
    const T& operator[](int i) const { return data_[i]; }
    void add(const T& value) {
        T copy = value;
        if (size_ == room_) make_room(room_ < 8 ? 8 : 2 * room_);
        new (data_ + size_++) T(copy);
    }
    void resize(int count) {  // new elements are made without arguments
        if (count > room_) make_room(count);
        while (size_ > count) data_[--size_].~T();
        while (size_ < count) new (data_ + size_++) T();
    }
    void clear() { resize(0); }
    T take() { return data_[--size_]; }  // the last one, of plain elements

private:
    void make_room(int room) {
        room_ = room, data_ = static_cast<T*>(realloc(static_cast<void*>(data_), sizeof(T) * size_t(room)));
        if (!data_) abort();  // there is no memory left
    }
};

// Sorts in place, keeping the order of equals: halves are sorted by themselves, then merged.
template <class T, class Less> void sort(T* begin, T* end, Less less) {
    if (end - begin < 16) {
        for (T* i = begin; i < end; i++)
            for (T* j = i; j > begin && less(*j, j[-1]); j--) swap(*j, j[-1]);
        return;
    }
    T* middle = begin + (end - begin) / 2;
    sort(begin, middle, less), sort(middle, end, less);
    List<T> first;
    for (T* i = begin; i < middle; i++) first.add(*i);
    T* to = begin;
    for (int i = 0; i < first.size();) *to++ = middle < end && less(*middle, first[i]) ? *middle++ : first[i++];
}

struct V3 { double x, y, z; };
inline V3 operator+(V3 a, V3 b) { return {a.x + b.x, a.y + b.y, a.z + b.z}; }
inline V3 operator-(V3 a, V3 b) { return {a.x - b.x, a.y - b.y, a.z - b.z}; }
inline V3 operator*(double s, V3 a) { return {s * a.x, s * a.y, s * a.z}; }
inline double dot(V3 a, V3 b) { return a.x * b.x + a.y * b.y + a.z * b.z; }
inline V3 cross(V3 a, V3 b) { return {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x}; }
inline double norm(V3 a) { return sqrt(dot(a, a)); }
inline V3 unit(V3 a) { return (1 / norm(a)) * a; }
inline V3 lowest(V3 a, V3 b) { return {least(a.x, b.x), least(a.y, b.y), least(a.z, b.z)}; }
inline V3 highest(V3 a, V3 b) { return {most(a.x, b.x), most(a.y, b.y), most(a.z, b.z)}; }
inline V3 times(V3 a, V3 b) { return {a.x * b.x, a.y * b.y, a.z * b.z}; }
inline V3 size_of(V3 a) { return {fabs(a.x), fabs(a.y), fabs(a.z)}; }
inline double clamp(double v, double low, double high) { return least(high, most(low, v)); }

// A point in the plane z = 1, or a pixel; z is 0.
using Point = V3;
inline Point flat(V3 p) { return {p.x / p.z, p.y / p.z, 0}; }

// The box along the axes around points.
struct Bounds {
    V3 low{ENDLESS, ENDLESS, ENDLESS}, high{-ENDLESS, -ENDLESS, -ENDLESS};
    void add(V3 p) { low = lowest(low, p), high = highest(high, p); }
};

// The corners in order of the convex outline of n points in the plane z = 0, with room for 2 n of them
// (A. M. Andrew 1979); sorts the points. Returns how many corners there are.
inline int outline(V3* points, int n, V3* found) {
    sort(points, points + n, [](V3 a, V3 b) { return a.x < b.x || (a.x == b.x && a.y < b.y); });
    int count = 0;
    for (int pass = 0; pass < 2; pass++) {
        int start = count;
        for (int i = 0; i < n; i++) {
            V3 p = points[pass ? n - 1 - i : i];
            while (count - start >= 2 && cross(found[count - 1] - found[count - 2], p - found[count - 2]).z <= 0) count--;
            found[count++] = p;
        }
        count--;
    }
    return most(count, 1);
}

// Cuts a convex polygon of n corners, with room for one more of each plane, to where heights are not above 0 (Sutherland
// and Hodgman 1974); returns how many corners are left.
template <int ROOM, class Height> int cut(V3 (&p)[ROOM], int n, Height height) {
    V3 kept[ROOM];
    int count = 0;
    for (int i = 0; i < n && count + 2 <= ROOM; i++) {
        V3 a = p[i], b = p[i + 1 == n ? 0 : i + 1];
        double from = height(a), to = height(b);
        if (from <= 0) kept[count++] = a;
        if ((from > 0) != (to > 0)) kept[count++] = a + (from / (from - to)) * (b - a);
    }
    memcpy(p, kept, sizeof(V3) * size_t(count));
    return count;
}

// Twice the area of an outline, in any plane.
inline V3 double_area(const V3* p, int n) {
    V3 sum{0, 0, 0};
    for (int i = 1; i + 1 < n; i++) sum = sum + cross(p[i] - p[0], p[i + 1] - p[0]);
    return sum;
}

// Corner i of a box about the origin: x slowest, z fastest.
inline V3 corner(int i, V3 half) { return {i & 4 ? half.x : -half.x, i & 2 ? half.y : -half.y, i & 1 ? half.z : -half.z}; }

// The pose X_AB of a frame B in a frame A: the upper rows of a 4 x 4 matrix; it maps coordinates in B to those in A.
struct Pose {
    double m[12] = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0};
    static Pose of(const double* rows) { Pose X; memcpy(X.m, rows, sizeof X.m); return X; }
    V3 origin() const { return {m[3], m[7], m[11]}; }
    V3 axis(int k) const { return {m[k], m[4 + k], m[8 + k]}; }
    V3 turn(V3 v) const {  // of a direction
        return {m[0] * v.x + m[1] * v.y + m[2] * v.z, m[4] * v.x + m[5] * v.y + m[6] * v.z, m[8] * v.x + m[9] * v.y + m[10] * v.z};
    }
    V3 turn_back(V3 v) const {
        return {m[0] * v.x + m[4] * v.y + m[8] * v.z, m[1] * v.x + m[5] * v.y + m[9] * v.z, m[2] * v.x + m[6] * v.y + m[10] * v.z};
    }
    // Half the sides of a box along the axes of A around one along those of B.
    V3 around(V3 half) const { return size_of(half.x * axis(0)) + size_of(half.y * axis(1)) + size_of(half.z * axis(2)); }
    V3 around_back(V3 half) const { return {dot(size_of(axis(0)), half), dot(size_of(axis(1)), half), dot(size_of(axis(2)), half)}; }
    V3 operator()(V3 p) const { return turn(p) + origin(); }  // of a point
    V3 back(V3 p) const { return turn_back(p - origin()); }
    Pose operator*(const Pose& X_BC) const {
        Pose X_AC;
        for (int i = 0; i < 3; i++)
            for (int j = 0; j < 4; j++)
                X_AC.m[4 * i + j] = m[4 * i] * X_BC.m[j] + m[4 * i + 1] * X_BC.m[4 + j] + m[4 * i + 2] * X_BC.m[8 + j] + (j == 3 ? m[4 * i + 3] : 0);
        return X_AC;
    }
    Pose inverse() const {
        Pose X_BA;
        for (int i = 0; i < 3; i++) {
            V3 a = axis(i);
            X_BA.m[4 * i] = a.x, X_BA.m[4 * i + 1] = a.y, X_BA.m[4 * i + 2] = a.z, X_BA.m[4 * i + 3] = -dot(a, origin());
        }
        return X_BA;
    }
};
