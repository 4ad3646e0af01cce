// The interface of the resolver plug-in for a client library in the same process.
#pragma once

namespace usdlive {

/// The functions that the plug-in exports for live projects. The plug-in and the library are built
/// separately and do not link to each other, so the interface uses C types only. Any thread may
/// call all functions except notify().
///
/// A live project has addresses of its own, `usdlive://HOST:PORT/@~TOKEN/PATH`: layers of the
/// project are the placeholder files in its folder, unless they are read as files, and all other
/// files are read from the server.
struct ResolverInterface {
    /// Returns the token for a live project, which is the same for the same arguments and valid
    /// until the process ends. `server` is `HOST:PORT`, `prefix` the name of the project with a
    /// slash if addresses name it, `folder` has the placeholders.
    const char* (*live)(const char* server, const char* prefix, const char* folder);
    /// Sets whether the server is reachable, and its `HOST:PORT`. While it is not, files outside
    /// the cache are not found. Call it once after live().
    void (*connected)(const char* token, const char* server, int isConnected);
    /// Sets whether a layer is a file like others, which has its content when it is opened. At
    /// first, none is.
    void (*readAsFile)(const char* token, const char* path, int isFile);
    /// Asks the server for its files. Calls `changed` for each file that was added, changed or
    /// removed since the last call, except for layers that are not read as files. Takes as long as
    /// a request, but ends soon after `isStopped` returns another number than 0. Returns 0 if the
    /// server did not answer.
    int (*refresh)(const char* token, void (*changed)(void* context, const char* path),
                   int (*isStopped)(void* context), void* context);
    /// Puts a file into the cache, and waits, unless `isStopped` returns another number than 0.
    /// Returns 0 if the project has the file, but it did not arrive.
    int (*fetch)(const char* token, const char* path, int (*isStopped)(void* context),
                 void* context);
    /// Between these two calls, nothing that a stage of the project composes waits for the server:
    /// lists of files are those that are known, and files that OpenUSD opens as layers are not
    /// found, or not opened, unless they are in the cache, or fetch() has returned 1 for them.
    /// endTick() calls `needed` for each file that was not found or opened for this reason.
    void (*beginTick)(const char* token);
    void (*endTick)(const char* token, void (*needed)(void* context, const char* path),
                    void* context);
    /// Makes the stages of the project resolve their asset paths again. Call it on the thread that
    /// owns them.
    void (*notify)(const char* token);
    /// Ends a live project. Its addresses find only what is in the cache.
    void (*close)(const char* token);
};

/// The name of the function that returns them, a ResolverInterfaceFunction. A change of the
/// interface changes the number.
inline constexpr const char* kResolverInterface = "usdliveResolverInterface3";
using ResolverInterfaceFunction = const ResolverInterface* (*)();

}  // namespace usdlive
