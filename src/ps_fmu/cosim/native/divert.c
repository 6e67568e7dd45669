/* A library calls a function of another one by the address in an entry of a table of its own, which the loader has
   filled in.  The entries of some functions get another address.

   A system call without the C library has no entry, nor has an address that a library has asked the loader for itself. */

#include "divert.h"

#include <dlfcn.h>
#include <elf.h>
#include <link.h>
#include <stdint.h>
#include <stdlib.h>
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

/* Whether a page is one of those that the loader has made read-only since: it leaves out the last one, if the part ends
   within, for there are variables behind. */
static int is_closed(const Object *object, uint64_t page, uint64_t size)
{
    const Elf64_Phdr *part = find_part(object, PT_GNU_RELRO);
    if (part == NULL)
        return 0;
    const uint64_t begin = object->dlpi_addr + part->p_vaddr, end = begin + part->p_memsz;
    return page >= (begin & ~(size - 1)) && page < (end & ~(size - 1));
}

static void write_entry(const Object *object, uint64_t offset, void *to)
{
    void **place = (void **)(object->dlpi_addr + offset);
    const uint64_t size = (uint64_t)sysconf(_SC_PAGESIZE), page = (uint64_t)place & ~(size - 1);
    const int closed = is_closed(object, page, size);
    if (closed && mprotect((void *)page, size, PROT_READ | PROT_WRITE) != 0)
        return;
    __atomic_store_n(place, to, __ATOMIC_RELAXED);
    if (closed)
        mprotect((void *)page, size, PROT_READ);
}

/* Whether an entry stands for the function `from`.  That of a call does, whatever it holds: before the first call an
   address of the library's own.  NULL: there is no such function.  A variable does as long as it has the value that the
   loader gave it. */
static int stands_for(const Object *object, const Elf64_Rela *entry, const void *from)
{
    const void *const *place = (const void *const *)(object->dlpi_addr + entry->r_offset);
    return *place != NULL && (ELF64_R_TYPE(entry->r_info) != R_X86_64_64 || (entry->r_addend == 0 && *place == from));
}

static void divert_entries(const Object *object, const Tables *tables, const Elf64_Rela *entries, uint64_t n,
                           const Diversion *all)
{
    for (const Elf64_Rela *entry = entries; entry != NULL && entry < entries + n; entry++) {
        const uint64_t type = ELF64_R_TYPE(entry->r_info);
        if (type != R_X86_64_JUMP_SLOT && type != R_X86_64_GLOB_DAT && type != R_X86_64_64)
            continue;
        const Elf64_Sym *symbol = &tables->symbols[ELF64_R_SYM(entry->r_info)];
        if (symbol->st_shndx != SHN_UNDEF) /* a function of its own */
            continue;
        for (const Diversion *one = all; one->name != NULL; one++)
            if (strcmp(tables->names + symbol->st_name, one->name) == 0 && stands_for(object, entry, one->from))
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

void find_functions(Diversion *all)
{
    for (; all->name != NULL; all++)
        all->from = dlsym(RTLD_DEFAULT, all->name);
}

/* A library is known by where it lies and where its name does. */
typedef struct {
    uint64_t address;
    const char *name;
} Known;

struct Loaded {
    size_t count;
    Known *libraries;
};

static int add_one(Object *object, size_t size, void *data)
{
    Loaded *loaded = data;
    (void)size;
    Known *more = realloc(loaded->libraries, (loaded->count + 1) * sizeof *more);
    if (more == NULL)
        return 1;
    loaded->libraries = more;
    more[loaded->count++] = (Known){object->dlpi_addr, object->dlpi_name};
    return 0;
}

Loaded *list_loaded(void)
{
    Loaded *loaded = calloc(1, sizeof *loaded);
    if (loaded != NULL && dl_iterate_phdr(add_one, loaded) != 0) { /* no memory */
        free(loaded->libraries);
        free(loaded);
        return NULL;
    }
    return loaded;
}

static int is_known(const Loaded *loaded, const Object *object)
{
    for (const Known *one = loaded->libraries; one < loaded->libraries + loaded->count; one++)
        if (one->address == object->dlpi_addr && one->name == object->dlpi_name)
            return 1;
    return 0;
}

typedef struct {
    const Loaded *before;
    const void *address;
    const Diversion *all;
} Walk;

static int divert_unknown(Object *object, size_t size, void *data)
{
    const Walk *walk = data;
    (void)size;
    if (!is_known(walk->before, object))
        divert(object, walk->all);
    return 0;
}

void divert_new(Loaded *before, const Diversion *all)
{
    Walk walk = {.before = before, .all = all};
    if (before == NULL)
        return;
    dl_iterate_phdr(divert_unknown, &walk);
    free(before->libraries);
    free(before);
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
