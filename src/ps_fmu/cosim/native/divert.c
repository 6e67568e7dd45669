/* A library calls a function of another one by the address in an entry of a table of its own, which the loader has
   filled in.  The entries of some functions get another address.

   A system call without the C library has no entry, nor has an address that a library has asked the loader for itself. */

#include "divert.h"

#include <elf.h>
#include <link.h>
#include <stdint.h>
#include <string.h>
#include <sys/mman.h>
#include <unistd.h>

typedef struct dl_phdr_info Object;

/* What is to be known of a library. */
typedef struct {
    const Elf64_Rela *data, *calls; /* entries for data and functions, entries for functions that are called */
    uint64_t n_data, n_calls, n_local; /* the first `n_local` for data have no name */
    const Elf64_Sym *symbols;
    const char *names;
} Tables;

static const Elf64_Phdr *find_part(const Object *object, uint32_t type)
{
    for (int k = 0; k < object->dlpi_phnum; k++)
        if (object->dlpi_phdr[k].p_type == type)
            return &object->dlpi_phdr[k];
    return NULL;
}

/* The loader has made addresses of most offsets. */
static const void *locate(const Object *object, uint64_t value)
{
    return (const void *)(value < object->dlpi_addr ? value + object->dlpi_addr : value);
}

static Tables find_tables(const Object *object)
{
    Tables found = {0};
    const Elf64_Phdr *part = find_part(object, PT_DYNAMIC);
    const Elf64_Dyn *entry = part == NULL ? NULL : (const void *)(object->dlpi_addr + part->p_vaddr);
    for (; entry != NULL && entry->d_tag != DT_NULL; entry++) {
        const uint64_t value = entry->d_un.d_val;
        switch (entry->d_tag) {
        case DT_RELA:
            found.data = locate(object, value);
            break;
        case DT_RELASZ:
            found.n_data = value / sizeof(Elf64_Rela);
            break;
        case DT_RELACOUNT:
            found.n_local = value;
            break;
        case DT_JMPREL:
            found.calls = locate(object, value);
            break;
        case DT_PLTRELSZ:
            found.n_calls = value / sizeof(Elf64_Rela);
            break;
        case DT_SYMTAB:
            found.symbols = locate(object, value);
            break;
        case DT_STRTAB:
            found.names = locate(object, value);
            break;
        }
    }
    return found;
}

/* Write an entry, also one that the loader has made read-only since. */
static void write_entry(const Object *object, uint64_t offset, void *to)
{
    void **place = (void **)(object->dlpi_addr + offset);
    const Elf64_Phdr *closed = find_part(object, PT_GNU_RELRO);
    const int is_closed = closed != NULL && offset - closed->p_vaddr < closed->p_memsz;
    const uint64_t size = (uint64_t)sysconf(_SC_PAGESIZE);
    void *page = (void *)((uint64_t)place & ~(size - 1));
    if (is_closed && mprotect(page, size, PROT_READ | PROT_WRITE) != 0)
        return;
    __atomic_store_n(place, to, __ATOMIC_RELAXED);
    if (is_closed)
        mprotect(page, size, PROT_READ);
}

static void divert_entries(const Object *object, const Tables *tables, const Elf64_Rela *entries, uint64_t n,
                           const Diversion *all)
{
    for (const Elf64_Rela *entry = entries; entry != NULL && entry < entries + n; entry++) {
        const uint64_t type = ELF64_R_TYPE(entry->r_info);
        if (type != R_X86_64_JUMP_SLOT && type != R_X86_64_GLOB_DAT && (type != R_X86_64_64 || entry->r_addend != 0))
            continue;
        const Elf64_Sym *symbol = &tables->symbols[ELF64_R_SYM(entry->r_info)];
        if (symbol->st_shndx != SHN_UNDEF) /* a function of its own */
            continue;
        for (const Diversion *one = all; one->name != NULL; one++)
            if (strcmp(tables->names + symbol->st_name, one->name) == 0)
                write_entry(object, entry->r_offset, one->to);
    }
}

static void divert(const Object *object, const Diversion *all)
{
    const Tables tables = find_tables(object);
    if (tables.symbols == NULL || tables.names == NULL)
        return;
    divert_entries(object, &tables, tables.calls, tables.n_calls, all);
    if (tables.n_local < tables.n_data)
        divert_entries(object, &tables, tables.data + tables.n_local, tables.n_data - tables.n_local, all);
}

/* A walk along all libraries, in the order in which they were loaded. */
typedef struct {
    unsigned long long loads;
    long count, first; /* libraries seen, and the first that is to be diverted */
    const void *address;
    const Diversion *all;
} Walk;

static int count_one(Object *object, size_t size, void *data)
{
    Walk *walk = data;
    (void)size;
    walk->loads = object->dlpi_adds;
    walk->count++;
    return 0;
}

unsigned long long count_loads(void)
{
    Walk walk = {0};
    dl_iterate_phdr(count_one, &walk);
    return walk.loads;
}

static int divert_late(Object *object, size_t size, void *data)
{
    Walk *walk = data;
    (void)size;
    if (walk->count++ >= walk->first)
        divert(object, walk->all);
    return 0;
}

void divert_new(unsigned long long before, const Diversion *all)
{
    Walk walk = {.all = all};
    dl_iterate_phdr(count_one, &walk);
    if (walk.loads == before)
        return;
    walk.first = walk.count - (long)(walk.loads - before);
    walk.count = 0;
    dl_iterate_phdr(divert_late, &walk);
}

static int divert_around(Object *object, size_t size, void *data)
{
    const Walk *walk = data;
    (void)size;
    for (int k = 0; k < object->dlpi_phnum; k++) {
        const Elf64_Phdr *part = &object->dlpi_phdr[k];
        if (part->p_type == PT_LOAD && (uint64_t)walk->address - object->dlpi_addr - part->p_vaddr < part->p_memsz)
            divert(object, walk->all);
    }
    return 0;
}

void divert_at(const void *address, const Diversion *all)
{
    Walk walk = {.address = address, .all = all};
    dl_iterate_phdr(divert_around, &walk);
}
