# fish completion for slf, which itself says what may follow.

function __slf_complete
    set -l words (commandline -opc) (commandline -ct)
    for line in ($words[1] __complete $words[2..-1] 2>/dev/null)
        switch $line
            case ':folders'
                __fish_complete_directories (commandline -ct)
            case ':files' ':files *'
                __fish_complete_suffix (string replace -r ':files ?' '' -- $line)
            case '*'
                echo $line
        end
    end
end
complete -c slf -f -k -a '(__slf_complete)'
